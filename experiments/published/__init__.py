"""What `experiments.literature` is made of: its figures and its page."""
