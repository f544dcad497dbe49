"""The camnet program; commands are thin: load, build, run, write."""
