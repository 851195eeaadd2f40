"""The version of edgemap, a leaf that every module may import."""

VERSION = "0.2.0"
