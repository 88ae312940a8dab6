"""How people see a result: figures, HTML, PDF, templates."""
