"""The exact judge: dilation, repair and the certified duration of a motion."""
