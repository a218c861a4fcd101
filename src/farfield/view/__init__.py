"""Pictures on the CPU: the reference renderer of worlds and the true picture from geometry."""
