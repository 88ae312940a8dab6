"""The history of arms: a database of results and events, its schema, its migrations, what is asked of it."""
