"""How a run is carried out: search, servo, recording, and which posture is next."""
