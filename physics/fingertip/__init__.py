"""The Beam Bundle fingertip: its surfaces, beams, skin, stick and slip."""
