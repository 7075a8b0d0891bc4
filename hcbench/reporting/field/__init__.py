"""`hcbench report field`: every engine that is there beside each other, for who chooses one."""
