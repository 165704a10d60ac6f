"""What mapod needs of others: the lock of their versions and hashes, and its bill of materials."""
