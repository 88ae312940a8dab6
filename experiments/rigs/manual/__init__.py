"""A person who moves the arm: postures are asked for, joint values are typed, or come from a file."""
