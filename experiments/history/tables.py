"""The tables of a history, as of `REVISION`. A change here is a new file in `migrations/versions/`.

Keys are natural, so that a copy into another database needs no numbering. Times are UTC without a zone.
"""

from __future__ import annotations

from sqlalchemy import (
    Column,
    DateTime,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
)

REVISION = "0001"

metadata = MetaData()

arm = Table(
    "arm",
    metadata,
    Column("serial", Text, primary_key=True),
    Column("model", Text, primary_key=True),  # the name of the robot
    Column("vendor", Text),
)

# `sha256` is of the run: a run has one result. JSON in text: `offsets` the rows of the result's parameters,
# `without_prior` and `sensitivity_mm2` as in the result (docs/files.md), null where it has none.
result = Table(
    "result",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("serial", Text, nullable=False),
    Column("model", Text, nullable=False),
    Column("measured_at", DateTime, nullable=False),
    Column("added_at", DateTime, nullable=False),
    Column("instrument", Text, nullable=False),
    Column("operator", Text, nullable=False),
    Column("run", Text, nullable=False),
    Column("shots", Integer, nullable=False),
    Column("verdict", String(16), nullable=False),
    Column("offsets", Text, nullable=False),
    Column("without_prior", Text),
    Column("sensitivity_mm2", Text),
    Column("made_by", Text, nullable=False),  # the version of zerobeam
    Column("document_sha256", String(64), nullable=False),
    ForeignKeyConstraint(["serial", "model"], ["arm.serial", "arm.model"]),
    Index("result_of_arm", "serial", "model", "measured_at"),
)

# The whole result.json, compressed (zlib): apart, so that no query of many results reads them.
document = Table(
    "document",
    metadata,
    Column("sha256", String(64), ForeignKey("result.sha256"), primary_key=True),
    Column("content", LargeBinary, nullable=False),
)

event = Table(
    "event",
    metadata,
    Column("serial", Text, primary_key=True),
    Column("model", Text, primary_key=True),
    Column("at", DateTime, primary_key=True),
    Column("what", String(16), primary_key=True),
    Column("note", Text, primary_key=True),
    ForeignKeyConstraint(["serial", "model"], ["arm.serial", "arm.model"]),
)
