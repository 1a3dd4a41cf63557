"""OSL text from traced models."""
