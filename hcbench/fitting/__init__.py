"""From a measurement of bounces to α with its uncertainty, and to the law that the data support."""
