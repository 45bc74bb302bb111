"""Where things stand: first values and re-fits of frames, points and cameras with the nominal robot."""
