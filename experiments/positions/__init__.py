"""Taught positions in backups of controllers: found, converted when zeros were entered, put back."""
