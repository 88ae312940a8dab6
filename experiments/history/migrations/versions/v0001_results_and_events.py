"""The first schema: arms, their results, the results' whole documents, events."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make the tables of an empty database."""
    op.create_table(
        "arm",
        sa.Column("serial", sa.Text, primary_key=True),
        sa.Column("model", sa.Text, primary_key=True),
        sa.Column("vendor", sa.Text),
    )
    op.create_table(
        "result",
        sa.Column("sha256", sa.String(64), primary_key=True),
        sa.Column("serial", sa.Text, nullable=False),
        sa.Column("model", sa.Text, nullable=False),
        sa.Column("measured_at", sa.DateTime, nullable=False),
        sa.Column("added_at", sa.DateTime, nullable=False),
        sa.Column("instrument", sa.Text, nullable=False),
        sa.Column("operator", sa.Text, nullable=False),
        sa.Column("run", sa.Text, nullable=False),
        sa.Column("shots", sa.Integer, nullable=False),
        sa.Column("verdict", sa.String(16), nullable=False),
        sa.Column("offsets", sa.Text, nullable=False),
        sa.Column("without_prior", sa.Text),
        sa.Column("sensitivity_mm2", sa.Text),
        sa.Column("made_by", sa.Text, nullable=False),
        sa.Column("document_sha256", sa.String(64), nullable=False),
        sa.ForeignKeyConstraint(["serial", "model"], ["arm.serial", "arm.model"]),
    )
    op.create_index("result_of_arm", "result", ["serial", "model", "measured_at"])
    op.create_table(
        "document",
        sa.Column("sha256", sa.String(64), sa.ForeignKey("result.sha256"), primary_key=True),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "event",
        sa.Column("serial", sa.Text, primary_key=True),
        sa.Column("model", sa.Text, primary_key=True),
        sa.Column("at", sa.DateTime, primary_key=True),
        sa.Column("what", sa.String(16), primary_key=True),
        sa.Column("note", sa.Text, primary_key=True),
        sa.ForeignKeyConstraint(["serial", "model"], ["arm.serial", "arm.model"]),
    )
