"""Create, Read, Update, Transfer, Delete: what each needs, does and leaves behind."""
