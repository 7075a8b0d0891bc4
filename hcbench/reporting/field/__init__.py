"""`hcbench report field`: all installed engines side by side, to help you choose one."""
