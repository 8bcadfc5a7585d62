"""The hand, the device between hand and computer, and the controller that keeps both passive."""
