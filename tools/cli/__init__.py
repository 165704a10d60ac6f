"""The commands of mapod, one file each."""
