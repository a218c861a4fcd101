"""How near a picture comes to the true one."""
