"""The virtual laser tracker."""
