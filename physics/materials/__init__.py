"""What tissue is made of: hyperelastic energies and viscoelastic chains."""
