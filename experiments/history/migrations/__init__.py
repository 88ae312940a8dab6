"""Alembic's environment: how a history of an earlier version of zerobeam becomes one of this."""
