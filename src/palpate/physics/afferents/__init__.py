"""Spikes of tactile afferents from the stress at their receptors (docs/equations/afferents.md)."""
