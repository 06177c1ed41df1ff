"""Controllers and policies side by side: metrics of episodes, tables, plots, and how near they come to the bound."""
