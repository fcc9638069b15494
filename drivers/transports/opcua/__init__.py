"""OPC UA devices: who is there, what they tell, what they can be asked for."""
