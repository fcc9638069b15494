"""The host's session with the server: facts go up, orders and files' receipts come down."""
