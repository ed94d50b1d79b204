"""A naive model of the whole store, and random sequences of operations that it judges."""
