"""Random dots by common fate: what tells patches that only their motion shows."""
