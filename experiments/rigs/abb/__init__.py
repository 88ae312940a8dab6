"""An ABB controller as a rig: access, Robot Web Services, Externally Guided Motion."""
