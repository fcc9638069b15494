"""Files that come and go: uploads, downloads, and pictures that strangers bring."""
