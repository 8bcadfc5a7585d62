"""Material laws of tissue: hyperelastic energies and viscoelastic chains."""
