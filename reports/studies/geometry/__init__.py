"""What the study `geometry` shows: page, tables and figures."""
