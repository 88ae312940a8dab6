"""How a run is carried out on any rig: search, servo, recording, and which posture is next."""
