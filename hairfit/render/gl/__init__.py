"""Pictures for the eye, by OpenGL without a window."""
