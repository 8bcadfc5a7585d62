"""Many sparse probes of one organ: pooled fit, stiffness map over its surface, inclusions."""
