"""python3 -m openmmrigidhi.accuracy"""
import sys

from .cli import main

if __name__ == '__main__':
    sys.exit(main())
