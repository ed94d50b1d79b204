"""Values that need no store: errors, stamps, policies, poses, records, checks of arguments."""
