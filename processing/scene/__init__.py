"""What mocks and simulations look at, and what each eye sees of it."""
