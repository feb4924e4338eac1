"""What client and service share: keys and sessions, requests, messages, errors."""
