"""What a recording is and holds before anything is stated; what limits say of units and signs."""
