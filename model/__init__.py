"""What is true: robot, tool, constraint, noise, parameters, plan, run, problem, kernel."""
