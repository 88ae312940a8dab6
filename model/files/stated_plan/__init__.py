"""What a plan file may state: postures, the constraints that they must keep, obstacles."""
