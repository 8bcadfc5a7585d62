"""Touches as a data set for robot learning, in the format of LeRobot (docs/lerobot.md)."""
