"""The app: a page in the browser, and the server that answers it by the same functions as the commands."""
