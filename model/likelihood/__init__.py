"""The measurements of a run as residuals, Jacobians and a density: symbolic, exact, compiled."""
