"""Which measurements to choose: exact designs and their bounds."""
