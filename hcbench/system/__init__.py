"""The world outside: errors, files, outputs, text, display, and compiled C."""
