"""Where the gap lies, how far it shrinks, what it costs on the task and what is left."""
