"""One file per published or recorded experiment."""
