"""People in depth images."""
