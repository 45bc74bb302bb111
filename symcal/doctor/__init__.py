"""What an installation has and lacks: packages, compiler, cache, fonts, processor, terminal; and what to do."""
