"""What puts lumpwatch beside a crusher."""
