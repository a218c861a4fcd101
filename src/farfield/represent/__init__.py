"""One file or folder per representation: how it is built, what it costs, how it is stored."""
