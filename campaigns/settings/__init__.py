"""campaign.yaml."""
