"""What is shown, as plain values made in memory."""
