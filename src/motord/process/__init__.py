"""What every process of this program shares: how it is started, how signals end it, its folder."""
