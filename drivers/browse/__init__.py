"""What devices say of themselves: OPC UA servers, SiLA 2 servers, OpenAPI documents."""
