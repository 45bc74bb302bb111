"""The only orchestrators: files in, a run folder out."""
