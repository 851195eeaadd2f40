"""The bundle and the networks in it: manifest, store, engines, preprocessing, decoding."""
