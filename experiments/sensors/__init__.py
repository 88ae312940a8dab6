"""Real sensors next to a controller: PSD amplifiers on serial lines, a camera by OpenCV, and their files."""
