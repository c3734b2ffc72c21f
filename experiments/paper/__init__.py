"""Code that the experiments on Ma et al. 2024 share."""
