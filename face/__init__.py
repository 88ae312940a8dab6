"""The Python face: what a program or a notebook holds in its hands, over what the rooms below do."""
