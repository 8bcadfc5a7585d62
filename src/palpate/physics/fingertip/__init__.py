"""The Beam Bundle fingertip: surfaces, beams, skin, stick and slip."""
