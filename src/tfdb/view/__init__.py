"""A page that shows a store in the browser: `tfdb view`."""
