"""The search: starts, hops and the finish; a dense interior point method, Ipopt at the end."""
