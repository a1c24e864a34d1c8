"""What a fit leaves behind: result folders and the report that shows them."""
