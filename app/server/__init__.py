"""The server of the app: what may be asked, of which files, and by whom."""
