"""Models of the hand and the haptic device, and the controller that keeps the loop passive."""
