"""The joints of a tree one by one: what each does in the passes of the articulated-body recursion."""
