"""The page of a plan, with its postures in 3D."""
