"""Tables of accuracy and of speed: presets and OpenCV's matchers side by side, on anybody's data."""
