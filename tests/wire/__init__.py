"""Tests of TFMessage bytes, with PyPI rosbags as the oracle."""
