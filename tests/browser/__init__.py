"""The page in a browser: Playwright with the Chromium of the system."""
