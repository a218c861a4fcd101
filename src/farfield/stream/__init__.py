"""What to send first: representations chosen by the benefit that they add for the time they take (BEN)."""
