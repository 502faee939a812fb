// The page for logging in needs no script.
