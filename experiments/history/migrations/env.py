"""What Alembic runs to migrate: on the connection, and in the transaction, of its caller (`database.py`)."""

from alembic import context

if hasattr(context, "config"):  # not where this module is only imported
    context.configure(connection=context.config.attributes["connection"])
    context.run_migrations()
