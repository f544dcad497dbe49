"""Strict YAML to frozen settings: worlds and recipes."""
