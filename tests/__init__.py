"""Tests, by room: test_hw_*, test_core_*, test_fakes_*, test_tools_*, test_app_*."""
