"""The page of all benches: what is known of each, and the pages that show it."""
