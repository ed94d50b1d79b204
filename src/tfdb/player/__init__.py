"""Playing recordings into a store, by the store's clock."""
