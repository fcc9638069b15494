"""What the laboratory consists of: kinds, nodes, the tree, poses and contents."""
