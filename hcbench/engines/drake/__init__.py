"""Drake: multibody plants, continuous and discrete, with compliant point contact."""
