"""The history of arms: a database of results and events, what is asked of it, drift, signatures."""
