"""Which paths a calculation or a command of the app may use."""
