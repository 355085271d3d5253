"""python3 -m openmmrigidhi.ensemble"""
import sys

from .cli import main

if __name__ == '__main__':
    sys.exit(main())
